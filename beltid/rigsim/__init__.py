"""The numerical experiment: the friction rig as a planar multibody model (Section 4)."""
