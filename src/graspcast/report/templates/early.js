"use strict";
(function () {
  let kept = null;
  try { kept = localStorage.getItem("graspcast-theme"); } catch (error) { /* not allowed here */ }
  if (kept === "dark" || kept === "light") document.documentElement.dataset.theme = kept;
})();
