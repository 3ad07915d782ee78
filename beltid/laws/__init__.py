"""The constitutive equations, Eqs. (1) to (9), as pure functions, each implemented only here.

=====================  ==============================================================  ==========
Module                 Responsibility                                                  Equation
=====================  ==============================================================  ==========
``penalty``            Normal contact: elastic force of a penetration; ``NormalLaw``   (3)
                       holds the coefficients
``capstan``            Equations of the friction rig: mu from two tensions, sliding    (5) to (8)
                       speed, normal force along the arc and its mean
``kelvin_voigt``       Material of the belt: force and moment of a section             (9)
``friction_surface``   mu(f_N, v) between and beyond the nodes of a grid, covariance   Section 2.2
``surface_tables``     The surface as arrays and the functions that evaluate them      Section 2.2
``bicubic``            Spline patches that stay between the values they join           Section 2.2
``slow_friction``      Friction surface below its slowest speed, for a drive           (D14)
``friction_formulas``  Parametric laws mu(f, v) in place of a surface                  beyond
=====================  ==============================================================  ==========

No module here imports a compiler: the kernels of the rig and of the drive compile these functions
unchanged.
"""
