"""What is compiled, ahead of time, when the package is installed; nothing else knows how.

Python in Cython's pure mode: each file also runs uncompiled, and the tests hold both to the same answers.
"""
