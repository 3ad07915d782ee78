"""Turn results into charts, pages and terminal tables; no science.

=============== ======================================================
Module          Responsibility
=============== ======================================================
``cells``       names and values in words, units and digits
``summary``     result of a stage for its user
``view``        what people see of an artifact
``terminal``    print a summary in the terminal
``results``     results of a belt, the input of charts and pages
``conditions``  settings of the runs: groups, test conditions
``style``       the look of charts
``charts``      registry of the charts; SVG, PNG and PDF
``figures``     the charts, a module per topic
``tables``      tables of a page, the gallery of runs
``verdict``     verdict, main results, limits of trust
``page``        the pages as data: one belt, several belts
``html``        render a page as one self-contained file
=============== ======================================================
"""
