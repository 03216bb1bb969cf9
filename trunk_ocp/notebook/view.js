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
    else if (data?.trunkPage === "drag") heard.dragged = data.detail;
    else if (data?.trunkPage === "time" || data?.trunkPage === "controls") {
      const { time, activation, head } = data.detail;
      for (const [name, value] of Object.entries({ time, activation, head })) {
        if (value !== undefined) heard[name] = value;
      }
    } else return;
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

  const tell = (name, detail) => {
    if (!saving) frame.contentWindow?.postMessage({ trunkPage: name, detail }, "*");
  };
  const tellTime = () => tell("time", { time: model.get("time") });
  const tellControls = () => {
    tell("controls", { activation: model.get("activation"), head: model.get("head") });
  };
  const tellPlan = () => tell("plan", model.get("plan"));

  /** A page that just opened gets what was set before, as after a reload of the notebook. */
  const greet = () => {
    if (model.get("plan")) tellPlan();
    if (model.get("time") > 0) tellTime();
    if (model.get("moved")) tellControls();
  };

  const listeners = [
    ["change:plan", tellPlan],
    ["change:time", tellTime],
    ["change:activation", tellControls],
    ["change:head", tellControls],
  ];
  addEventListener("message", hear);
  for (const listener of listeners) model.on(...listener);
  el.replaceChildren(frame);
  return () => {
    removeEventListener("message", hear);
    for (const listener of listeners) model.off(...listener);
    clearTimeout(timer);
  };
}

/** Whether two traits have the same value. */
function same(a, b) {
  return JSON.stringify(a) === JSON.stringify(b);
}

export default { render };
