"""The numerical experiment: the friction rig as a planar multibody model (Sections 3 and 4).

A bench (``model``) becomes a belt of ANCF elements (``mesh``, ``belt``: Eqs. (9), (10)) on a pulley
(``contact``: (1) to (4), (11)). ``newton`` finds one equilibrium and marches through many; ``lcp``
solves the same step as the paper's complementarity problem, (11), (12). ``steady`` lays the belt on
and slides it, ``transient`` turns the pulley in time, ``runs`` is the entry for one run or a
campaign, and ``flow`` lets the belt run over a turning pulley, for the drive.
"""
