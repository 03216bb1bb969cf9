// The page of a plan or a trunk in a notebook's cell: an iframe whose numbers are the widget's.
//
// Messages are {trunkPage: name, detail}, as bridge.js of the page defines them. Only those of the
// iframe's own window are heard: a notebook has other frames, and other windows can send, too.

const PERIOD = 50; // ms between two messages to Python while the page moves

function render({ model, el }) {
  const frame = document.createElement("iframe");
  frame.setAttribute("sandbox", "allow-scripts"); // a page without rights in the notebook
  frame.style.cssText = `display:block;border:0;width:100%;height:${model.get("height")}px`;
  frame.title = "trunk";
  frame.srcdoc = model.get("page");

  let heard = {}; // what the page said since the last message to Python
  let timer = null;
  let saving = false; // then changes come from the page, which need not hear them again

  const hear = ({ source, data }) => {
    if (source !== frame.contentWindow) return;
    if (data?.trunkPage === "ready") greet();
    if (data?.trunkPage !== "time" && data?.trunkPage !== "controls") return;
    const { time, activation, head } = data.detail;
    for (const [name, value] of Object.entries({ time, activation, head })) {
      if (value !== undefined) heard[name] = typeof value === "number" ? value : Array.from(value);
    }
    timer ??= setTimeout(save, PERIOD);
  };

  const save = () => {
    const news = Object.entries(heard).filter(([name, value]) => !same(value, model.get(name)));
    [heard, timer] = [{}, null];
    saving = true;
    for (const [name, value] of news) model.set(name, value);
    saving = false;
    if (news.length) model.save_changes();
  };

  const tell = (name, ...traits) => {
    if (saving) return;
    const detail = Object.fromEntries(traits.map((trait) => [trait, model.get(trait)]));
    frame.contentWindow?.postMessage({ trunkPage: name, detail }, "*");
  };
  const tellTime = () => tell("time", "time");
  const tellControls = () => tell("controls", "activation", "head");

  /** A page that just opened gets what was set before, as after a reload of the notebook. */
  const greet = () => {
    if (model.get("time") > 0) tellTime();
    if (model.get("moved")) tellControls();
  };

  addEventListener("message", hear);
  model.on("change:time", tellTime);
  model.on("change:activation", tellControls);
  model.on("change:head", tellControls);
  el.replaceChildren(frame);
  return () => {
    removeEventListener("message", hear);
    model.off("change:time", tellTime);
    model.off("change:activation", tellControls);
    model.off("change:head", tellControls);
    clearTimeout(timer);
  };
}

/** Whether two numbers, or lists of numbers, are the same. */
function same(a, b) {
  return String(a) === String(b);
}

export default { render };
