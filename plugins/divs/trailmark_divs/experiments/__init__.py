"""The experiments of Perroni Filho & Ohya 2014 (Sec. V) in the simulator, a module for each figure.

Written in the words of a config, so that every part can be swapped there: nothing here imports another plugin.
"""
