// Words and numbers in the reader's language, and elements that hold them.

const say = (text, values = {}) => text.replace(/\{(\w+)\}/g, (_, name) => values[name]);
const formats = {}; // of numbers, by language and decimals: slow to make
const fixed = (value, count) => {
  const language = document.documentElement.lang;
  formats[language + count] ??= new Intl.NumberFormat(language, { minimumFractionDigits: count, maximumFractionDigits: count });
  return formats[language + count].format(Math.abs(value) < 0.5 / 10 ** count ? 0 : value); // no minus before zero
};

function element(kind, text) {
  const made = document.createElement(kind);
  made.textContent = text;
  return made;
}

function row(kind, ...cells) {
  const made = document.createElement("tr");
  made.append(...cells.map(cell => element(kind, cell)));
  return made;
}
