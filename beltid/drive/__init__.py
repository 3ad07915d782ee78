"""Prediction of a belt drive from the identified laws; equations (D1) to (D15) of the theory page.

A ``Drive`` (``model``) is laid out (``geometry``), its belt is a ``string`` on its pulleys, which a
``loop`` tightens and closes. The ``simulator`` solves operating points by strings or rods for their
``results``; ``limits`` are the largest torques, ``agreement`` that with measured speed losses.
"""
