"""What a run is judged by: its figures, the limits that it is compared with (bounds), its costs,
the summary, the progress in the terminal, and drawings of the orchard (plans, as SVG).
"""
