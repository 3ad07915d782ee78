"""Contact of belt and pulley.

==============  ==================================================================  ==========
Module          Responsibility                                                      Equation
==============  ==================================================================  ==========
``points``      State of the contact points; normal forces                          (1) to (4)
``forces``      Friction by status; forces and tangent assembled                    (11), (12)
``friction``    Stick or slide: certificate and update of a step                    (11), (12)
``ribs``        Ribs of a running belt that shear                                   (R7)
==============  ==================================================================  ==========
"""
