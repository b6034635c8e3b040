/** Page of all terms, with a search. */

import { TextInput } from "@mantine/core";
import { useState } from "react";
import { Card } from "../../components/Card";
import { EntryText } from "../../components/Explanation";
import { countThings } from "../../samples/texts";
import { type Entry, KIND_TITLES, search } from "../../service/glossary";
import page from "../Page.module.css";
import styles from "./Glossary.module.css";
import { TEXTS } from "./texts";

export default function GlossaryPage() {
  const [text, setText] = useState("");
  const found = search(text);
  const kinds = Object.keys(KIND_TITLES) as Entry["kind"][];
  return (
    <div className={page.page}>
      <h1 className={page.title}>{TEXTS.title}</h1>
      <p className={page.lead}>{TEXTS.lead}</p>
      <search className={styles.search}>
        <TextInput
          label={TEXTS.search}
          placeholder={TEXTS.searchHint}
          value={text}
          onChange={(event) => setText(event.currentTarget.value)}
        />
        <output className={page.dim} aria-label={TEXTS.found}>
          {countThings(found.length, "entry", "entries")}
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
