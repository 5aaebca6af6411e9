"""One large cloth on several processes, by MPI and PETSc (extra ``[mpi]``)."""
