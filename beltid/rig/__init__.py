"""The numerical experiment: the friction rig as a planar multibody model (Sections 3 and 4).

A bench (``model``) becomes a belt of ANCF elements (``mesh``) on a pulley, with the ``forces`` of
Eqs. (1) to (4) and (9) to (11). ``newton`` finds one equilibrium and marches through many; ``lcp``
solves the same step as the paper's complementarity problem, (11), (12). ``runs`` lays the belt on,
slides it and turns the pulley in time; ``flow`` lets the belt run over a pulley of a drive.
"""
