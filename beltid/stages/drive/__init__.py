"""The belt drive that the parameters were identified for.

==================== =========================================================== ===============
Module               Responsibility                                              Equation
==================== =========================================================== ===============
``simulate_drive``   predict speed loss, forces and slip limit of a drive        section 2.2
``compare_drive``    compare predicted with measured speed losses
``drive_of_config``  build the drive of a config and its operating points
==================== =========================================================== ===============
"""
