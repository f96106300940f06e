"""What is known of a collapse beside its load factor: a file for each kind of answer."""

from importlib import import_module
from pkgutil import iter_modules

for _file in iter_modules(__path__):  # each has its kind of answer
    import_module(f"{__name__}.{_file.name}")
