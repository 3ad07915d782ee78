"""The charts of the reports; importing it registers them.

============ ============================================================ =======================
Module       Charts                                                       The paper's figures
============ ============================================================ =======================
``bench``    press, speed loss, runs over time, along the arc, the drive  Figs. 4, 5, 9, 10, 11
``friction`` coefficients, the surface, measured against simulated        Figs. 12, 13, 16, 17
============ ============================================================ =======================
"""

from beltid.report.figures import bench, friction

__all__ = ["bench", "friction"]
