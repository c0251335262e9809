"""The built-in dispatch policies, one file each. `orchard.agents.dispatch` has their names; docs/policies.md compares them."""
