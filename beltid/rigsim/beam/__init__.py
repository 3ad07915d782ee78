"""Model the belt as a planar beam from support A over the pulley to support B.

==============  ==================================================================  ========
Module          Responsibility                                                      Equation
==============  ==================================================================  ========
``path``        Span, arc, span; mesh refined where the belt lifts off
``ancf``        Cable element: shape functions, mass, strains, tangent              (10)
``belt``        Assembly of the elements: internal and inertia forces               (9), (10)
``supports``    Supports A and B as constraints; support forces                     (10)
==============  ==================================================================  ========
"""
