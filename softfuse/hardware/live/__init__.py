"""From the chunks of all sources to estimates, as they come: the live loop.

    chunk -> driver -> device's clock -> assembler -> frame -> senses -> estimate -> publisher
          \\-> recorder

Everything up to the frame is a function of the chunks alone (`pipeline`), so that a replayed recording gives
the same frames; threads and queues are in `session`.
"""
