"""drpbench: does a manipulator policy survive a moving world?"""

__version__ = "0.1.0"
