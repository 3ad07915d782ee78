"""Prediction of a belt drive from the identified laws.

============  ====================================================================  ==============
Module        Responsibility                                                        Equation
============  ====================================================================  ==============
``model``     Pulleys, installation and operating point of a drive
``geometry``  Tangent spans, wrap angles, arm of the tensioner
``string``    The belt on its pulleys: strain, seating, creep, sliding, torque      (D1) to (D6)
``rod``       The belt on one pulley with its bending stiffness
``loop``      Span forces, flow of belt and tensioner of the closed loop            (D7) to (D9)
``results``   Speed loss and its parts, hub forces, reserve, losses, status         (D10), (D11)
``limits``    Torque with which adhesion ends, and slip limit, by bisection
``agreement`` Predicted against measured speed losses; what a recording resolves
============  ====================================================================  ==============

The equations are those of the page on theory, sections on the belt drive. The commands predict at
string level; the rod level stands beside it, a pulley at a time.
"""
