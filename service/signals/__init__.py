"""Signals of one window to look at: waveform, spectra, synchronous average, transmission error, worn flank.

`subject.py` is a window with all that is known of its machine; `views.py` is the table of views, each a function from
a subject and its options to a `View` of plain arrays; `pictures.py` and `tables.py` draw and write one.
"""
