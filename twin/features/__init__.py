"""Signal features: what a measurement window says before any model looks at it.

level               RMS in a band
angle               shaft angle from encoder edges, smoothed
resample            band-limited interpolation onto an even grid of pinion angle
transmission_error  from the two encoders
orders              complex lines at chosen orders, mesh bands, synchronous averages
mesh_speed          speed from the mesh lines where there is no encoder
extract             all of it for one window
"""
