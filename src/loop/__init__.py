"""The closed loop: a UAV that flies on the predictions of a perception.

May import `sim` and `models`; neither imports it.
"""
