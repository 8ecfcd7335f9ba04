"""Stages that press: three axes moved by G-code."""
