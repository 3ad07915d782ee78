"""From reduced runs to the friction surface mu(f_N, v) (paper, section 2.2).

================  =========================================================  =====================
Module            Responsibility                                             Equation
================  =========================================================  =====================
``surface``       runs -> surface of each arc and their average, or one      Figs. 12 and 13,
                  smooth surface of runs that are no grid; the table         mixed model
``curves``        runs -> curves over the force per arc and speed; their     ln mu over ln f_N,
                  mean over the arcs, with standard errors                   random effects
``laws``          parametric friction laws fitted to the surface             mixed model
================  =========================================================  =====================
"""
