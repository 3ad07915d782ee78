"""Choose the next runs of the friction rig, and decide when to stop.

`candidates` puts what is known and the settings of the rig into a linear model, `design` chooses
runs. The equations are on the theory page, section "Planning the next runs".
"""
