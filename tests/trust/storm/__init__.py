"""Hostile input through the front door: whole commands, in workers that are watched.

``tests/trust/fuzz.py`` gives mangled bytes and words to readers. This gives whole commands what is wrong in its
structure: configs grown from the program's own schema, recordings whose records are wrong, stores whose rows are,
surroundings that are odd, arguments from the program's own tree of commands::

    python -m tests.trust.storm --cases 20000
    python -m tests.trust.storm --record storm.jsonl --minutes 30       # goes on where it was when it is called again
    python -m tests.trust.storm --only config --first 17 --cases 1      # one case again, and what it said

A case is made from (target, number) alone. `oracle` says what a finding is.
"""
