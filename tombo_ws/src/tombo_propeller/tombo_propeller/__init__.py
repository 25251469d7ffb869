"""The propeller workbench: the paper reproduced, and propellers designed."""
