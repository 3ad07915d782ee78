"""Prediction of a belt drive from the identified laws; equations (D1) to (D15) of the theory page.

A ``Drive`` (``model``) is laid out (``geometry``), its belt is a ``string`` on its pulleys, which a
``loop`` tightens and closes under load. The ``simulator`` solves operating points, with a rod on
each pulley if asked. ``results`` are speed losses, forces and reserves, ``limits`` the largest
torque and the belts within their tolerance, ``agreement`` compares with measured speed losses.
"""
