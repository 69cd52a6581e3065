//! Full disks, folders that cannot be written, two writers at once.
