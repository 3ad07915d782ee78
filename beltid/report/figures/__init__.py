"""The figures of the reports, a module per topic.

============ =============================================== ==================
Module       Responsibility                                  The paper's figure
============ =============================================== ==================
``press``    force and deformation of the normal contact     Figs. 4, 5
``slip``     sliding speed in service over torque            Fig. 9
``runs``     tensions and coefficient of runs over time      Fig. 10
``arc``      normal force along the arc                      Fig. 11
``friction`` coefficients of all runs over force             Figs. 12, 16
``surface``  the surface in space, in slices, as a map       Fig. 13
``proof``    measured against simulated, differences         Fig. 17
``drive``    a predicted drive: loss, forces, limits
``budget``   where the uncertainty comes from
``belts``    several belts side by side                      Figs. 12, 17
``single``   the figures of one artifact on its own
============ =============================================== ==================
"""
