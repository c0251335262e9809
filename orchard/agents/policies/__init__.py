"""The built-in dispatch policies, one file each. `orchard.agents.dispatch` has their names; docs/bounds.md compares them."""
