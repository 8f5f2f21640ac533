"use strict";
(function () {
  if (!window.Bokeh || !window.IntersectionObserver) {
    return;
  }
  Bokeh.logger.set_level("error");
  // Bokeh's buttons are reached by the keyboard; this tells screen readers that they are buttons
  function name_buttons(node) {
    if (node.title && /Button/.test(node.className)) {
      node.setAttribute("role", "button");
      node.setAttribute("aria-label", node.title.split("\n")[0]);
    }
    Array.prototype.forEach.call(node.children, name_buttons);
    if (node.shadowRoot) {
      Array.prototype.forEach.call(node.shadowRoot.children, name_buttons);
    }
  }
  function show(figure) {
    var live = figure.querySelector(".live");
    var item = JSON.parse(figure.querySelector("script").textContent);
    Bokeh.embed.embed_item(item, live.id).then(function () {
      figure.classList.add("shown");
      live.setAttribute("role", "group");
      live.setAttribute("aria-label", figure.dataset.live);
      name_buttons(live);
    });
  }
  var watch = new IntersectionObserver(function (seen) {
    seen.forEach(function (each) {
      if (each.isIntersecting) {
        watch.unobserve(each.target);
        show(each.target);
      }
    });
  }, {rootMargin: "300px"});
  document.querySelectorAll("figure[data-live]").forEach(function (figure) {
    watch.observe(figure);
  });
})();
