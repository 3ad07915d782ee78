"""The belt as a planar beam, from one support over the pulley to the other.

==============  ==================================================================  ========
Module          Responsibility                                                      Equation
==============  ==================================================================  ========
``path``        Support, arc, support; mesh graded to where the belt lifts off
``ancf``        Cable element: shape functions, mass, strains, tangent              (10)
``belt``        The elements assembled: internal and inertia forces                 (9), (10)
``supports``    Supports A and B as constraints, their forces                       (10)
==============  ==================================================================  ========
"""
