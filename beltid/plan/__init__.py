"""Choose the next runs of the friction rig, and decide when to stop."""
