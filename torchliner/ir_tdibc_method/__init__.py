"""The incident wave alone drives the liner: its velocity follows, step by step (section 3.1)."""
