"""The linearised Euler equations in a straight lined duct, condensed column by column.

In this order: ``mesh`` (rectangular elements) and ``basis`` (polynomials of one); ``columns`` (an
element as what goes in and out of its edges, a column likewise, of its sides and its lined wall);
``sweep`` (all columns, for every unit wave into the duct); ``walls``, ``ends`` (what comes back
there) and ``ports`` (the small system that holds Z); ``solver`` (what is called) and ``field``
(what it returns). ``verification`` measures the error.
"""
