/** An entry of the glossary, as it is shown in place and in the list of all. */

import { inWords, readingOf } from "../samples/quantity";
import { type Entry, KIND_TITLES } from "../service/glossary";
import { useAngles } from "../service/preferences";
import styles from "./Explained.module.css";
import { Written } from "./values";

/** Kinds whose terms are symbols, written as the paper does. */
const SYMBOLS: ReadonlySet<string> = new Set(["signal", "quantity", "parameter"]);

export function EntryText({ entry, listed = false }: { entry: Entry; listed?: boolean }) {
  const angles = useAngles();
  const { term, name, unit, meaning, equation, source, more } = entry;
  return (
    <div className={styles.entry}>
      <div className={styles.head}>
        <span className={styles.name}>
          {SYMBOLS.has(entry.kind) && !term.includes(".") ? <Written name={term} /> : term}
        </span>
        {unit && <span className={styles.unit}>[{readingOf(unit, angles).unit}]</span>}
        {listed ? (
          name !== term && <code className={styles.kind}>{name}</code>
        ) : (
          <span className={styles.kind}>{KIND_TITLES[entry.kind]}</span>
        )}
      </div>
      <p className={styles.meaning}>{inWords(meaning, angles)}</p>
      {equation && <p className={styles.equation}>{equation}</p>}
      {more && (
        <dl className={styles.more}>
          {more.map(([heading, text]) => (
            <div key={heading}>
              <dt>{heading}</dt>
              <dd>{inWords(text, angles)}</dd>
            </div>
          ))}
        </dl>
      )}
      {source && <p className={styles.source}>{source}</p>}
    </div>
  );
}
