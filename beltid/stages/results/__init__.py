"""Output of existing results for people and other programs.

==================== ===========================================================================
Module               Responsibility
==================== ===========================================================================
``report_belt``      write the results of one or more belts as an HTML page
``show_artifact``    show any artifact as a table and a figure
``export_law``       export the contact law to other programs
``law_of_belt``      assemble the contact law from artifacts
``belt_results``     read the results in the folder of a belt
``recorded_curves``  keep the parts of recordings that the figures need
==================== ===========================================================================
"""
