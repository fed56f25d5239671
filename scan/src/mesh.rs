//! Meshes of stations.
