// Put into a page to see, once it is loaded, what is on its canvas; tells it in a script element.
(() => {
  const errors = [];
  window.addEventListener("error", (event) => errors.push(String(event.message)));
  window.addEventListener("unhandledrejection", (event) => errors.push(String(event.reason)));
  window.addEventListener("load", () => {
    // The page draws when the window changes; its pixels are there until the end of that frame.
    window.dispatchEvent(new Event("resize"));
    requestAnimationFrame(() => tell(share(document.querySelector("canvas"))));
  });

  function share(canvas) {
    if (!canvas) return null;
    const copy = document.createElement("canvas");
    copy.width = canvas.width;
    copy.height = canvas.height;
    if (!copy.width || !copy.height) return 0;
    const context = copy.getContext("2d");
    context.drawImage(canvas, 0, 0);
    const pixels = context.getImageData(0, 0, copy.width, copy.height).data;
    let drawn = 0;
    for (let i = 3; i < pixels.length; i += 4) drawn += pixels[i] > 0;
    return drawn / (pixels.length / 4);
  }

  function tell(drawn) {
    const overflow = document.documentElement.scrollWidth - window.innerWidth;
    const told = document.createElement("script");
    told.type = "application/json";
    told.id = "probe";
    told.textContent = JSON.stringify({ errors, drawn, overflow });
    document.body.append(told);
  }
})();
