/* Ranks the sections of the site by the words of a question: BM25 (Robertson and Zaragoza 2009), with
   the words of a title counted several times. SECTIONS has [page, anchor, titles, text] of each. */
"use strict";

const SHOWN = 10;
const SATURATION = 1.2, BY_LENGTH = 0.6; // k1 and b of BM25
const TITLE = 6, PAGE_TITLE = 2; // how often a word counts in the title of a section, and of its page
const NAME = 0.5; // of a public name, beside the chapters, unless it is asked for as it is written
const PREFIX = 0.5; // of a word that only begins with the word of the question
const COMMON = new Set(
  ("a an and are as at be by can do does for from get has have how i if in into is it its me my need of " +
   "on onto or our over should take that the their there this to use using want was we what when where " +
   "which who why will with you your").split(" ")
);

function stem(word) {
  for (const [end, put] of [["ies", "y"], ["sses", "ss"], ["ing", ""], ["ed", ""], ["s", ""], ["e", ""]]) {
    if (word.endsWith(end) && word.length - end.length >= 3 && !word.endsWith("ss")) {
      return stemOfDoubled(word.slice(0, word.length - end.length) + put);
    }
  }
  return word;
}

function stemOfDoubled(word) { // of "pinned": pin
  const doubled = /([bdgmnprt])\1$/.test(word);
  return (doubled ? word.slice(0, -1) : word).replace(/e$/, "");
}

function wordsOf(text) { // SelfContact counts as itself, and as "self contact"
  const parts = (text.normalize("NFKC").match(/[\p{L}\p{N}]+/gu) || []).flatMap((word) => {
    const pieces = word.match(/\p{Lu}\p{Ll}+/gu) || [];
    return pieces.length > 1 ? [word, ...pieces] : [word];
  });
  return parts.map((word) => word.toLowerCase()).filter((word) => !COMMON.has(word)).map(stem);
}

function counted(words) {
  const counts = new Map();
  for (const [word, weight] of words) counts.set(word, (counts.get(word) || 0) + weight);
  return counts;
}

const UNITS = SECTIONS.map(([page, anchor, titles, text]) => {
  const own = titles[titles.length - 1];
  const words = [
    ...wordsOf(text).map((word) => [word, 1]),
    ...wordsOf(own).map((word) => [word, TITLE]),
    ...wordsOf(titles.slice(0, -1).join(" ")).map((word) => [word, PAGE_TITLE]),
  ];
  return { page, anchor, titles, text, counts: counted(words), length: words.length };
});
const MEAN_LENGTH = UNITS.reduce((sum, unit) => sum + unit.length, 0) / UNITS.length;

function countIn(unit, word) {
  const exact = unit.counts.get(word) || 0;
  if (exact || word.length < 4) return exact;
  let most = 0;
  for (const [other, count] of unit.counts) if (other.startsWith(word)) most = Math.max(most, count);
  return PREFIX * most;
}

function ranked(question) {
  const words = [...new Set(wordsOf(question))];
  const scores = new Map();
  let all = 0;
  for (const word of words) {
    const counts = UNITS.map((unit) => countIn(unit, word));
    const having = counts.filter((count) => count > 0).length;
    const rarity = Math.log(1 + (UNITS.length - having + 0.5) / (having + 0.5));
    all += rarity;
    counts.forEach((count, i) => {
      if (!count) return;
      const room = SATURATION * (1 - BY_LENGTH + BY_LENGTH * UNITS[i].length / MEAN_LENGTH);
      const known = scores.get(i) || { score: 0, found: 0 };
      known.score += rarity * count * (SATURATION + 1) / (count + room);
      known.found += rarity;
      scores.set(i, known);
    });
  }
  const results = [...scores].map(([i, { score, found }]) => ({
    unit: UNITS[i], // a section with all words, or the rare ones, comes first
    score: score * found / all * weight(UNITS[i], question.trim().toLowerCase()),
  }));
  return { words, results: results.sort((a, b) => b.score - a.score) };
}

function weight(unit, question) {
  const own = unit.titles[unit.titles.length - 1].toLowerCase();
  if (own === question || `fecloth.${own}` === question || `fc.${own}` === question) return 4;
  return unit.page.startsWith("api/") ? NAME : 1;
}

function excerpt(text, words) { // the 240 characters with the most words of the question
  const parts = [...text.matchAll(/\S+/g)];
  const hits = parts.filter((part) => wordsOf(part[0]).some((word) => words.includes(word)));
  const starts = hits.map((hit) => Math.max(0, hit.index - 60));
  const kinds = (start) => new Set(hits.filter((hit) => hit.index >= start && hit.index < start + 240)
    .flatMap((hit) => wordsOf(hit[0]).filter((word) => words.includes(word)))).size;
  const start = starts.reduce((most, at) => (kinds(at) > kinds(most) ? at : most), starts[0] || 0);
  const cut = text.slice(start, start + 240);
  return (start ? "… " : "") + cut.replace(start ? /^\S*\s/ : /^/, "").replace(/\s\S*$/, "") + " …";
}

function show(question) {
  const list = document.getElementById("results"), told = document.getElementById("told");
  const { words, results } = ranked(question);
  const shown = results.slice(0, SHOWN);
  for (const { unit } of shown) {
    const item = document.createElement("li"), link = document.createElement("a");
    link.href = `${unit.page}#${unit.anchor}`;
    link.textContent = unit.titles.join(" › ");
    const words_around = document.createElement("p");
    words_around.textContent = excerpt(unit.text, words);
    item.append(link, words_around);
    list.append(item);
  }
  told.textContent = shown.length
    ? `The first ${shown.length} of ${results.length} sections with these words.`
    : "No section has any of these words.";
}

const question = new URLSearchParams(location.search).get("q") || "";
document.getElementById("question").value = question;
if (question.trim()) show(question);
