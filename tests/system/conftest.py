"""The system tests start mpirun themselves, so ranks of an outer one have nothing to do here."""

from mpi4py import MPI

collect_ignore_glob = ["test_*.py"] if MPI.COMM_WORLD.size > 1 else []
