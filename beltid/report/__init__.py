"""Turn results into charts, pages and terminal tables; no science.

=============== ======================================================
Module          Responsibility
=============== ======================================================
``results``     results of a belt, the input of charts and pages
``charts``      registry of the charts, their style; SVG, PNG and PDF
``figures``     the charts, a module per topic
``tables``      tables of a page, the gallery of runs
``verdict``     verdict, main results, limits of trust
``conditions``  test conditions
``page``        the pages as data: one belt, several belts
``html``        render a page as one self-contained file
``cells``       names and values in words, units and digits
``summary``     result of a stage for its user
``terminal``    print a summary in the terminal
=============== ======================================================
"""
