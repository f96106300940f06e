document.querySelectorAll("figure.moving").forEach(function (figure) {
  var slider = figure.querySelector("input");
  var blocks = figure.querySelectorAll("[data-motion]");
  function move() {
    var s = Number(slider.value);
    blocks.forEach(function (block) {
      var m = block.getAttribute("data-motion").split(" ").map(Number);
      block.setAttribute("transform", "matrix(1 " + s * m[0] + " " + -s * m[0] + " 1 " +
        s * m[1] + " " + s * m[2] + ")");
    });
  }
  figure.querySelector(".slider").hidden = false;
  slider.addEventListener("input", move);
  move();
});
