"""Turn results into charts, pages and terminal tables; no science.

=============== ==========================================================
Module          Responsibility
=============== ==========================================================
``cells``       names and values in words, units and digits; tables
``summary``     result of a stage for its user: as text, JSON and CSV
``results``     results of a belt, the input of charts and pages
``view``        what people see of an artifact
``charts``      registry and look of the charts; SVG, PNG and PDF
``figures``     the charts, a module per topic
``verdict``     verdict, main results, limits of trust, test conditions
``page``        the pages: one belt, several belts; their HTML
=============== ==========================================================
"""
