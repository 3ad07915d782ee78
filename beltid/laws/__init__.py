"""The constitutive equations, Eqs. (1) to (9), as pure functions, each implemented only here.

=====================  ==============================================================  ==========
Module                 Responsibility                                                  Equation
=====================  ==============================================================  ==========
``penalty``            Normal contact: elastic force of a penetration, dissipation     (1) to (4)
                       while approaching; ``NormalLaw`` holds the coefficients
``capstan``            Equations of the friction rig: mu from two tensions, sliding    (5) to (8)
                       speed, normal force along the arc and its mean
``kelvin_voigt``       Material of the belt: force and moment of a section             (9)
``friction_surface``   mu(f_N, v) between and beyond the nodes of a grid               Section 2.2
``uncertain_surface``  Friction surface with covariance and bands                      beyond
``slow_friction``      Friction surface below its slowest speed, for a drive           (D14)
``surface_tables``     The surface as arrays and the functions that evaluate them      Section 2.2
``bicubic``            Spline patches that stay between the values they join           Section 2.2
``friction_formulas``  Parametric laws mu(f, v) in place of a surface                  beyond
=====================  ==============================================================  ==========

No module here depends on a compiler: :mod:`beltid.rigsim.compiled_laws` compiles what the simulated
rig calls. Equations applied to data: (3) in ``identify.press``, (6) in ``identify.friction``, (7)
in ``identify.slip``, (8) in ``identify.friction`` and ``rigsim.profile``. Equations applied to the
simulated belt: (1) to (4) in ``rigsim.contact``, (9) in ``rigsim.beam``.
"""
