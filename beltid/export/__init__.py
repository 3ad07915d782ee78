"""Export the contact law of a belt: an open law file, and input for other programs.

A target receives as much of the law as it can represent; its files state how far the rest is off.
"""
