"""Model the contact of belt and pulley.

==============  ==================================================================  ==========
Module          Responsibility                                                      Equation
==============  ==================================================================  ==========
``points``      State of the contact points; normal forces                          (1) to (4)
``forces``      Friction by status; assembly of forces and tangent                  (11), (12)
``friction``    Stick or slide: certificate and update of a step                    (11), (12)
``ribs``        Shear of the ribs of a running belt                                 (R7)
==============  ==================================================================  ==========
"""
