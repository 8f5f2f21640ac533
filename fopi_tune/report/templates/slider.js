"use strict";
(function () {
  var data = JSON.parse(document.getElementById("curves").textContent);
  var slider = document.getElementById("slider");
  var told = document.getElementById("slider-value");
  function show(k) {
    told.textContent = data.labels[k];
    slider.setAttribute("aria-valuetext", data.labels[k]);
    Object.keys(data.curves).forEach(function (key) {
      document.getElementById("moved-" + key).setAttribute("d", data.curves[key][k]);
    });
  }
  slider.addEventListener("input", function () {
    show(Number(slider.value));
  });
  show(Number(slider.value));
})();
