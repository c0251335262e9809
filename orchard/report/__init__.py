"""What a run is judged by: figures, bounds, the summary, the progress in the terminal, the plan as
SVG.
"""
