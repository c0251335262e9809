"""The Parquet tables of a run: bodies, events, messages, calls, exchanges and the summary."""
