"""Sources: what bytes come from (ports, by threads) and what they mean (drivers, pure).

    port -> Connection -> Chunk -> driver -> Reading

A port is where threads and clocks are; a driver is a function of the chunks in the order in which they were
read, so that a recording of the chunks gives the same readings. An empty chunk stands for an interruption:
the line was cut before it, and whatever had begun is forgotten.
"""
