"""The tables that a run leaves as Parquet files: bodies, events, messages, calls, exchanges and the summary."""
