"""Results for people and for other programs; nothing is computed anew.

==================== ===========================================================================
Module               Responsibility
==================== ===========================================================================
``report_belt``      the results of a belt, or several, as a page
``show_artifact``    any artifact as a table and a drawing
``export_law``       the contact law for other programs
``law_of_belt``      the contact law put together from artifacts
``belt_results``     the results in the folder of a belt
``recorded_curves``  what the figures need of the recordings
==================== ===========================================================================
"""
