"""In the tests this is found in place of the package torch: vamvs asks only where its libraries are."""
