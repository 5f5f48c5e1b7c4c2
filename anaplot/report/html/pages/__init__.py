"""Reports of the commands beside `report`: of strips, of epochs, of plans."""
