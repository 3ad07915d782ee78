"""Speed-loss recordings: the sliding speeds of a belt in service.

================  ====================================================  ========
Module            Responsibility                                        Equation
================  ====================================================  ========
``slip``          recording -> sliding speed of every operating point   (7)
``pooled_means``  means of short runs, noise pooled over a series
``points``        operating points; creep and gross slip
``rig_speeds``    pulley speeds that the friction rig has to cover      v = omega R
================  ====================================================  ========
"""
