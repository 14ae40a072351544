"""A simulator of its own, and a bench: are the poses that `retrue` gives right, and does it know when they are not?

It shares no code with `retrue`, so that it cannot share its mistakes: lenses are maps of the complex plane, rotations
are quaternions, scenes are traced ray by ray. Only public names of `retrue` are called, to be judged.
"""
