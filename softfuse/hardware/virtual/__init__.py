"""A device that is not there: what its sensors would say, as the bytes of the wire protocol on a real port.

    read(times) -> board -> packets -> faults -> outlet (pseudo-terminal, TCP on loopback) -> whoever listens

`board` and `faults` are pure and repeatable; only `ports` and `serving` touch the operating system.
"""
