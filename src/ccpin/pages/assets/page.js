"use strict";
// "show everywhere": one button sets the same tab on every group that has it
for (const button of document.querySelectorAll("button[data-all]"))
  button.addEventListener("click", () => {
    for (const tab of document.querySelectorAll(`input[data-tab="${button.dataset.all}"]`)) tab.checked = true;
  });
