"""Fits a scenario to the user's own log of bins, and tests it on a day that the fit did not see."""
