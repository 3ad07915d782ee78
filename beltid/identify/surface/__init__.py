"""From reduced runs to the friction surface mu(f_N, v) (paper, section 2.2).

================  =========================================================  =====================
Module            Responsibility                                             Equation
================  =========================================================  =====================
``surface``       runs -> surface of each arc and their average; the table   Figs. 12 and 13
``curves``        runs -> curves over the force per arc and speed            ln mu over ln f_N
``average``       mean over the arcs on a common grid, standard errors       random effects
``scattered``     runs that are no grid -> one smooth surface                mixed model
``laws``          parametric friction laws fitted to the surface             mixed model
================  =========================================================  =====================
"""
