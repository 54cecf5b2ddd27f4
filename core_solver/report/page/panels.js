// Facts, people and what is worth knowing, as words.

function node(name, className, text) {
  const element = document.createElement(name);
  if (className) element.className = className;
  if (text !== undefined) element.textContent = text;
  return element;
}

function sayFacts() {
  const list = document.getElementById("facts");
  for (const [name, value] of page.facts) {
    const pair = node("div");
    pair.append(node("dt", "", name), node("dd", "", value));
    list.append(pair);
  }
}

class PeoplePanel {
  constructor() {
    const list = document.getElementById("people");
    this.cards = people.map((person) => this.card(list, person));
    this.everybody = document.getElementById("everybody");
    this.everybody.addEventListener("click", () => choose(null));
    if (!people.length) list.append(node("p", "missing", "Nobody is in this take."));
  }

  card(list, person) {
    const card = node("div", "person");
    card.style.setProperty("--colour", person.css);
    const pick = node("button", "pick");
    pick.type = "button";
    pick.setAttribute("aria-label", `Choose ${person.name}`);
    const now = node("div", "now");
    const feet = ["L", "R"].map((side) => node("span", "foot", side));
    const words = node("span");
    now.append(node("span", "", `seen in ${Math.round(100 * person.seen)} %`), ...feet, words);
    card.append(pick, node("div", "name", person.name), node("div", "height", `${person.height.toFixed(2)} m`), now);
    card.addEventListener("click", () => {
      if (getSelection().isCollapsed) choose(person.index);  // somebody may be selecting text
    });
    list.append(card);
    return { person, card, pick, feet, words };
  }

  draw() {
    this.everybody.setAttribute("aria-pressed", state.person === null);
    for (const { person, card, pick, feet, words } of this.cards) {
      const chosen = state.person === person.index;
      card.classList.toggle("chosen", chosen);
      card.classList.toggle("faded", isFaded(person));
      pick.setAttribute("aria-pressed", chosen);
      feet.forEach((foot, side) => {
        const rests = person.contacts[2 * state.frame + side] > 127;
        foot.classList.toggle("rests", rests);
        foot.title = `${side ? "right" : "left"} foot ${rests ? "rests" : "moves"}`;
      });
      words.textContent = isFilled(person) ? "not seen here: filled in" : errorNow(person);
    }
  }
}

function errorNow(person) {
  const error = person.reprojection ? person.reprojection[state.frame] : NaN;
  return Number.isNaN(error) ? "" : `${error.toFixed(1)} px off the picture`;
}

const SPAN_BUTTONS = 3;

// Those that the sentence names, in the order of time.
function longest(spans) {
  const byLength = [...spans].sort((one, other) => other[1] - other[0] - (one[1] - one[0]));
  return byLength.slice(0, SPAN_BUTTONS).sort((one, other) => one[0] - other[0]);
}

class FindingsPanel {
  constructor() {
    const list = document.getElementById("findings");
    this.items = page.findings.map((finding) => this.item(list, finding));
    document.getElementById("findings-count").textContent = page.findings.length || "";
    if (!page.findings.length) list.append(node("li", "none", "Nothing stands out in this take."));
  }

  item(list, finding) {
    const item = node("li");
    const mark = node("span", "mark");
    if (finding.person !== null) mark.style.setProperty("--colour", people[finding.person].css);
    const moments = node("span", "moments");
    item.append(mark, node("span", "said", finding.text), moments);
    for (const [first] of longest(finding.spans)) {
      const button = node("button", "", `${videoFrame(first)}`);
      button.type = "button";
      button.setAttribute("aria-label", `Go to frame ${videoFrame(first)}: ${finding.text}`);
      button.addEventListener("click", () => {
        pause();
        scrubTo(first);
        change({ person: finding.person });
      });
      moments.append(button);
    }
    list.append(item);
    return { finding, item };
  }

  draw() {
    for (const { finding, item } of this.items)
      item.classList.toggle("now", finding.spans.some(([first, last]) => first <= state.frame && state.frame <= last));
  }
}
