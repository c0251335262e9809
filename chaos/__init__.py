"""A seeded soak: harvests whose processes are killed and frozen, whose links are cut, and who hear nonsense. See docs/reliability.md."""
