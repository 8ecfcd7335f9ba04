"""The paper's test bed: a stage presses a body at force levels, and all that is measured is written down."""
