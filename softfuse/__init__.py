"""Where, how hard and into what shape a soft robot is being pushed, from the sensors inside it.

`import softfuse as sf` gives the names of `__init__.pyi`, each imported when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
