"""The items of a report about the controller."""

from tombo_diagnosis.control.controller import ControllerReport
from tombo_diagnosis.report.page import controller_items


def test_a_controller_that_has_not_changed_is_named_once():
    (item,) = controller_items(ControllerReport((), (), (), (), "that of the healthy flights"))
    assert "By its gains the controller is the same as that of the healthy flights." in item.lines
