"""Colours of figures and pages, and what they mean."""

from __future__ import annotations

# Okabe and Ito's colours, told apart with any kind of colour vision. What they mean is the same in every figure, and
# lines differ in style and areas in hatching as well: a grey print says the same.
LAW = "#0072B2"  # what happens: forces, residuals, probabilities
LIMIT = "#D55E00"  # what must not be passed
EVENT = "#009E73"  # instants, marked cases
INK = "#222222"
FAINT = "#767676"
AREA = "#56B4E9"  # fill below a distribution's curve
