"""Prediction of a belt drive from the identified laws.

=============  ===================================================================  ==============
Module         Responsibility                                                       Equation
=============  ===================================================================  ==============
``model``      Pulleys, installation and operating point of a drive
``geometry``   Tangent spans, wrap angles, arm of the tensioner
``string``     The belt on its pulleys: strain, seating, creep, sliding, torque     (D1) to (D6),
                                                                                    (D13)
``rod``        The belt on one pulley with its bending stiffness                    (R1) to (R6)
``loop``       Span forces, flow of belt and tensioner of the closed loop           (D7) to (D9)
``bending``    Extra length of a loop whose belt bends                              (D15)
``rod_level``  The same loop with a rod on each pulley                              (D12)
``results``    Speed loss and its parts, hub forces, reserve, losses, status        (D10), (D11)
``profile``    Line force and sliding speed along the arcs of a result
``limits``     Torque at which adhesion ends, and slip limit, by bracketing
``first_call`` Entry point of a process that compiles ahead
``agreement``  Predicted against measured speed losses; what a recording resolves
=============  ===================================================================  ==============

The equations are on the theory page, sections on the belt drive.
"""
