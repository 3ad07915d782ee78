"""The charts of the reports, a module per topic; importing it registers them.

============ ================================================= ========================
Module       Charts                                            The paper's figures
============ ================================================= ========================
``friction`` coefficients of all runs, the surface             Figs. 12, 13, 16
``bench``    press, speed loss, runs over time, along the arc  Figs. 4, 5, 9, 10, 11
``proof``    measured against simulated, uncertainties         Fig. 17
``drive``    a predicted drive: loss, forces, limits
============ ================================================= ========================
"""

from beltid.report.figures import bench, drive, friction, proof

__all__ = ["bench", "drive", "friction", "proof"]
