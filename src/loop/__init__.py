"""The closed loop: a UAV that flies on what a perception believes, and what comes of it.

May import `sim` and `models`; neither imports it.
"""
