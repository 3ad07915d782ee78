"""Turn results into figures, pages and terminal tables; no science.

=============== ======================================================
Module          Responsibility
=============== ======================================================
``results``     results of a belt, the input of a report
``figures``     the figures, a module per topic
``drawing``     style of the figures; reproducible SVG, PNG and PDF
``tables``      tables of a page
``verdict``     verdict and main results at the top of a page
``conditions``  test conditions
``gallery``     all runs over time as small pictures
``belt_page``   the report of one belt
``belts_page``  several belts side by side
``html``        render sections as one self-contained page
``summary``     result of a stage for its user
``terminal``    print a summary in the terminal
=============== ======================================================
"""
