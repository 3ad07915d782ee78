"""Prediction of a belt drive from the identified laws; equations (D1) to (D15) of the theory page.

A ``Drive`` (``model``) is laid out (``geometry``) and its belt tightened (``rest``). The belt on
its pulleys is a ``string`` or consists of ``rods``; ``loop`` closes it under load. ``results``
reads speed losses, forces and reserves from the solution, ``limits`` looks for the largest torque
and for the belts within their tolerance, ``agreement`` compares with measured speed losses.
"""
