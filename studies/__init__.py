"""Studies of the project, each in a folder with its page, plan, code, tests and small tables.

They use `src`; nothing in `src` imports them.
"""
