// Access: code and tables that scroll are reached by the keyboard, and landmarks have names.
const scrolling = ".md-typeset pre > code, .md-typeset__scrollwrap";

function mend() {
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  document.querySelectorAll(".md-code__nav").forEach((nav, at) => nav.setAttribute("aria-label", `Code ${at + 1}`));
  for (const one of document.querySelectorAll(scrolling)) {
    if (one.scrollWidth > one.clientWidth) one.tabIndex = 0;
    else one.removeAttribute("tabindex");
  }
}

// The theme adds its parts after the page has been loaded.
let due = 0;
const plan = () => { cancelAnimationFrame(due); due = requestAnimationFrame(mend); };
new MutationObserver(plan).observe(document.body, {childList: true, subtree: true});
addEventListener("resize", plan);
plan();
