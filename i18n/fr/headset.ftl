### Messages pour les casques (www/headset/). La page ne les charge que si le navigateur en a un.

headsetEnter = Voir en réalité virtuelle
headsetLeave = Quitter la réalité virtuelle
headsetLoading = Chargement de la réalité virtuelle…
headsetInside = Le casque affiche le modèle.
headsetEnded = La réalité virtuelle est terminée.
headsetFailed = La réalité virtuelle n’a pas pu démarrer : { $why }
headsetNoWebgl = ce navigateur ne peut pas dessiner pour un casque (WebGL 2).
headsetLost = La réalité virtuelle s’est arrêtée parce que la carte graphique a été réinitialisée. Vous pouvez la relancer.
headsetClosed = La réalité virtuelle s’est arrêtée parce que le modèle a été fermé.
headsetWalk = Stick gauche : marcher
headsetTurn = Stick droit, à gauche ou à droite : tourner
headsetJump = Stick droit, vers l’avant : viser, puis relâcher pour se téléporter
headsetMeasure = Gâchette : choisir deux points pour mesurer une distance
headsetBack = Bouton de préhension : annuler le point, ou supprimer la dernière mesure
headsetHelp = X ou A : afficher ou masquer cette aide
headsetMissed = Il n’y a pas de surface à cet endroit.
