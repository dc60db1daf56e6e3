"""Settings that all tests share."""

from hypothesis import settings

settings.register_profile("house", deadline=None, derandomize=True)  # no timed assertion, the same examples every time
settings.load_profile("house")
