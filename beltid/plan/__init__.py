"""Choose the next runs of the friction rig, and decide when to stop.

`candidates` puts settings of the rig as rows of the linear model, `knowledge` holds the surface
before and after runs, `advice` chooses them. The equations are on the theory page, section
"Planning the next runs".
"""
