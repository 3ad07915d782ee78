"""The constitutive equations, each implemented only here, as pure functions without a compiler.

The kernels of the rig and of the drive compile some of them unchanged.
"""
