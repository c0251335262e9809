"""How fast it is, beside what else one could use: `python -m bench`, which writes docs/benchmarks.md."""
