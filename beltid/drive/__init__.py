"""Prediction of a belt drive from the identified laws.

============  ====================================================================  ==============
Module        Responsibility                                                        Equation
============  ====================================================================  ==============
``model``     Pulleys, installation and operating point of a drive
``geometry``  Tangent spans, wrap angles, arm of the tensioner
``string``    The belt on its pulleys: strain, seating, creep, sliding, torque      (D1) to (D6)
``loop``      Span forces, flow of belt and tensioner of the closed loop            (D7) to (D9)
``results``   Speed loss and its parts, hub forces, reserve, losses, status         (D10), (D11)
============  ====================================================================  ==============

The equations are those of the page on theory, section "The belt drive: string level".
"""
