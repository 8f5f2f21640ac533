"use strict";
(function () {
  var data = JSON.parse(document.getElementById("curves").textContent);
  var slider = document.getElementById("slider");
  var number = document.getElementById("number");
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
  if (number) {
    number.addEventListener("change", function () {
      var places = data.places[Number(number.value)];
      document.getElementById("slider-first").textContent = data.labels[places[0]];
      document.getElementById("slider-last").textContent = data.labels[places[1]];
      slider.max = places[1];
      slider.min = places[0];
      slider.value = places[2];
      show(places[2]);
    });
  }
  show(Number(slider.value));
})();
