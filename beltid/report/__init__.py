"""Results to figures, pages and terminal tables; no science.

=============== ======================================================
Module          Responsibility
=============== ======================================================
``results``     what a report is made of
``figures``     the figures, a module per topic
``drawing``     how figures look; SVG, PNG and PDF with the same bytes
``tables``      tables of a page
``verdict``     what stands on top of a page
``conditions``  what was tested, and how
``gallery``     all runs over time as small pictures
``belt_page``   the report of one belt
``belts_page``  several belts side by side
``html``        sections to one self-contained page
``summary``     what a stage tells its user
``terminal``    a summary for the terminal
``braille``     a figure for the terminal
=============== ======================================================
"""
