"""The Rerun recording of a run: writes frames into it, and arranges its views in a blueprint."""
