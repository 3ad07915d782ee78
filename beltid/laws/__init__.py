"""The constitutive equations, Eqs. (1) to (9): pure functions, each the one that runs.

=====================  ==============================================================  ==========
Module                 Responsibility                                                  Equation
=====================  ==============================================================  ==========
``penalty``            Normal contact: elastic force of a penetration, dissipation     (1) to (4)
                       while approaching; ``NormalLaw`` holds the coefficients
``capstan``            Friction rig on paper: mu of two tensions, sliding speed,       (5) to (8)
                       normal force along the arc and its mean
``kelvin_voigt``       Material of the belt: force and moment of a section             (9)
``friction_surface``   mu(f_N, v) between and beyond the nodes of a grid               Section 3
``uncertain_surface``  The same with the covariance of its nodes, bands, ensembles     beyond
``slow_friction``      The same below its slowest speed, for a drive                  (D14)
``surface_tables``     The surface as arrays and the functions that read them          Section 3
``bicubic``            Spline patches that stay between the values they join           Section 3
``friction_formulas``  Parametric laws mu(f, v) in place of a surface                  beyond
=====================  ==============================================================  ==========

Nothing here knows a compiler: :mod:`beltid.rigsim.compiled_laws` compiles what the simulated rig
calls. Where the equations meet data: (3) ``identify.press``, (6) ``identify.friction``, (7)
``identify.slip``, (8) ``identify.friction`` and ``rigsim.profile``; where they meet the simulated
belt: (1) to (4) ``rigsim.contact``, (9) ``rigsim.beam``.
"""
