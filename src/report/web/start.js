// Brings the page to life. Without scripts it still shows everything but the viewer.

async function startViewer(box) {
  const fail = (reason) => {
    const message = box.nextElementSibling;
    box.hidden = true;
    box.classList.remove("steered");
    message.textContent = `The 3-D viewer cannot run: ${reason}. Still pictures follow.`;
    message.hidden = false;
    report("viewer", "stills");
    report("ready", "true");
  };
  try {
    if (typeof DecompressionStream === "undefined") throw new Error("this browser is too old");
    const classes = JSON.parse(document.getElementById("classes").textContent);
    const viewer = new Viewer(box, classes, all("script.scene"), fail);
    box.hidden = false;
    box.classList.add("steered");
    nameScenes(
      box.querySelector("select"),
      all(".still h3").map((title) => title.textContent),
    );
    await viewer.open(0);
    connectControls(viewer);
    report("viewer", "3d");
  } catch (error) {
    fail(error.message);
  }
}

all(".table table").forEach(makeSortable);
all(".plot[data-stops]").forEach(makeReadable);
all(".sheet button").forEach(makeZoomable);
count("tables", ".table table");
count("curves", ".run polyline.mean");
count("pictures", ".sheet img");
count("scenes", "script.scene");

const box = document.querySelector(".viewer");
if (box) startViewer(box);
else report("ready", "true");
