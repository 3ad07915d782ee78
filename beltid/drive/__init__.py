"""Prediction of a belt drive from the identified laws; equations (D1) to (D15) of the theory page.

A ``Drive`` is laid out (``model``), its belt is a ``string`` on its pulleys, which a ``loop``
tightens and closes. The ``simulator`` solves operating points by strings or rods for their
``results``, and finds the largest torques; ``agreement`` is that with measured speed losses.
"""
