"""Prediction of a belt drive from the identified laws.

=============  ===================================================================  ==============
Module         Responsibility                                                       Equation
=============  ===================================================================  ==============
``model``      Pulleys, installation and operating point of a drive
``geometry``   Tangent spans, wrap angles, arm of the tensioner
``string``     The belt on its pulleys: strain, seating, creep, sliding, torque     (D1) to (D6)
``rest``       The belt at rest: tension, length, arm of the tensioner
``loop``       Span forces, flow of belt and tensioner of the closed loop           (D7) to (D9)
``rods``       The same loop with a rod on each pulley                              (D12), (D15)
``results``    Speed loss and its parts, hub forces, reserve, losses, status        (D10), (D11)
``limits``     Torque at which adhesion ends, and slip limit
``tolerance``  The drive with belts of least, mean and largest length
``agreement``  Predicted against measured speed losses; what a recording resolves
=============  ===================================================================  ==============

The equations are on the theory page, sections on the belt drive.
"""
