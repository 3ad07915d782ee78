"""The numerical experiment: the friction rig as a planar multibody model (Section 4).

==================  ==============================================================  ==========
Module              Responsibility                                                  Equation
==================  ==============================================================  ==========
``rig``             Front door: one run, or a campaign of runs                      (6), (8)
``model``           Path, mesh, belt, pulley and supports of a run; the bench
``path``            Support, arc, support; mesh graded to where the belt lifts off
``ancf``            Cable element: shape functions, mass, strains, tangent          (10)
``belt``            The elements assembled: internal and inertia forces             (9), (10)
``supports``        Supports A and B as constraints, their forces                   (10)
``contact``         State of the contact points; normal forces                      (1) to (4)
``contact_forces``  Friction by status; forces and tangent assembled                (11), (12)
``friction``        Stick or slide: certificate and update of a step                (11), (12)
``steady``          Belt laid on and tightened; the limit of full sliding
``transient``       One implicit step, and the march through a run                  (10) to (12)
``transient_run``   Schedule of a run in time, and what comes of it
``profile``         Forces, speeds and tension along the arc                        (8)
``sensitivity``     Derivatives of the tensions with respect to mu
``lcp``             Lemke's method, independent of the active set                   (11), (12)
``reference_step``  A step by Lemke's method on the Delassus matrix                 (12)
``banded``          Banded LU factorisation and solution
``compiled``        The compiler's decorators and their cache
``compiled_laws``   :mod:`beltid.laws`, compiled for the kernels                    (1) to (9)
==================  ==============================================================  ==========
"""
