"""The course's figures, their errors and their times on one page: `report SCENE --course`."""
