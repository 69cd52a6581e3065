//! Damaged and hostile data sets end in an error that names the place.
