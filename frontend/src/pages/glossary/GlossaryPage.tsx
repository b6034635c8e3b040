/** All words that the page explains, to be looked up. */

import { TextInput } from "@mantine/core";
import { useState } from "react";
import { Card } from "../../components/Card";
import { EntryText } from "../../components/Explanation";
import { type Entry, KIND_TITLES, search } from "../../service/glossary";
import page from "../Page.module.css";
import styles from "./Glossary.module.css";

export default function GlossaryPage() {
  const [text, setText] = useState("");
  const found = search(text);
  const kinds = Object.keys(KIND_TITLES) as Entry["kind"][];
  return (
    <div className={page.page}>
      <h1 className={page.title}>Glossary</h1>
      <p className={page.lead}>
        Every symbol, figure, verdict and fault of these pages. Each explains itself in place as well: point
        at it, tap it, or go to it with the Tab key and on to the next with the arrow keys.
      </p>
      <search className={styles.search}>
        <TextInput
          label="Look up"
          placeholder="a symbol, a word, a unit"
          value={text}
          onChange={(event) => setText(event.currentTarget.value)}
        />
        <output className={page.dim} aria-label="Found">
          {found.length === 1 ? "1 entry" : `${found.length} entries`}
        </output>
      </search>
      {kinds.map((kind) => {
        const entries = found.filter((entry) => entry.kind === kind);
        if (entries.length === 0) return null;
        return (
          <Card key={kind} title={KIND_TITLES[kind]}>
            <ul className={styles.entries}>
              {entries.map((entry) => (
                <li key={entry.name}>
                  <EntryText entry={entry} listed />
                </li>
              ))}
            </ul>
          </Card>
        );
      })}
    </div>
  );
}
